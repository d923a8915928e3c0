"""Many stations."""
