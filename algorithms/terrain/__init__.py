"""The ground below scans: which points lie on it, the models of heights, and where water runs."""
