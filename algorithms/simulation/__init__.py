"""Virtual scanner."""
