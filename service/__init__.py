"""Web, queue, files and command line."""
