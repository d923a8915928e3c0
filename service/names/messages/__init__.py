"""What pages and reports say to people, in every language side by side."""
