"""Points as normal distributions in the cells of a grid, and scans laid on each other by them."""
