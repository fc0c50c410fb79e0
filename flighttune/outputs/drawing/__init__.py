"""Charts as SVG, the colours of runs, and the templates of pages and files."""
