"""What every room uses: errors, units, arrays, quantities, files and the parts of an answer."""
