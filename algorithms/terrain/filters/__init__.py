"""Which points lie on the ground: one method a file."""
