"""What speaks for each of the poses that were found, in log-odds that add up. No verdict rests on it yet."""
