"""Libraries of segments: building, storing and opening them."""
