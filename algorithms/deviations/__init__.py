"""How far a surface lies from another one, and whether that means anything."""
