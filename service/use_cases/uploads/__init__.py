"""Files on their way in, inspected, kept, and given back."""
