"""The reproducible figures and tables of the paper, by the labels of its source."""
