"""What each result says: tables, sentences and advice, one file a subject."""
