"""Results that survive."""
