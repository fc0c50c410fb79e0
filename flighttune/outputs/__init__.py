"""Outputs of the program: answers, pages, recordings and exports."""
