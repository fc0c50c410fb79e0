"""What leaves the program: pages, recordings and exports."""
