"""What processes are asked for: inputs and options; of small processes the answer beside them."""
