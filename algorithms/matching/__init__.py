"""Which primitive is which."""
