"""What speaks for each of the poses that were found, in log-odds that add up (MATH 5.6)."""
