"""How good a registration is, and whether to accept it."""
