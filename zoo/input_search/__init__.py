"""Search for a network's input: try colours, crops and scales on a recording."""
