"""Resumable uploads, kept locally or shared."""
