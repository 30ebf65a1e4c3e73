"""Whether the contract of a detector is right: its variants, compared on pictures."""
