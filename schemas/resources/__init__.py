"""What the service keeps, as it is listed: files, jobs, keys, uploads, processes."""
