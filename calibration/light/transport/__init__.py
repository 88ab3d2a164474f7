"""Light transport learned from photographs of known pictures, on top of what a model expects."""
