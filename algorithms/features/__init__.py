"""From scans to uncertain 3-D primitives."""
