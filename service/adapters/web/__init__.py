"""The server underneath the web application."""
