"""What the benches are held against: exact references and other programs."""
