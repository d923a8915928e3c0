"""What a scan is."""
