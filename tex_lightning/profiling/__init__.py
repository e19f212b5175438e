"""What a network costs: time, arithmetic and memory, measured on this machine."""
