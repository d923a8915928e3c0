"""Jobs: submitted, found, watched, described, dismissed, and whose turn it is."""
