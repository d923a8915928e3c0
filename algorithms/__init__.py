"""Numerics of registration: arrays in, arrays out. See CONVENTIONS.md beside this file."""
