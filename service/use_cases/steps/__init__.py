"""What computing processes do, step by step, and the plans that order the steps."""
