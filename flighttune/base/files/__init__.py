"""Files: read strictly, written whole and with their hash; what ships with the package."""
