"""Requests to other machines: sources and callbacks, with addresses checked and pinned."""
