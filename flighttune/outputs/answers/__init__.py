"""The answers of all results: tables, sentences and advice, one file for each subject."""
