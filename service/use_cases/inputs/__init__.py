"""What a request may say, and whether it can be meant."""
