"""Pages, drawings and tables made of results."""
