"""The items that can be made again: figures and tables of the paper by the labels of its source."""
