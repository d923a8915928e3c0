"""Who may do what, and requests that are sent again."""
