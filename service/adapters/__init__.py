"""Storage and processes behind the ports."""
