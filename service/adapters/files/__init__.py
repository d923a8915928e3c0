"""Contents in folders and object stores."""
