"""Quotas, rates, and shares of the machine."""
