"""Libraries of segments: build, store, open and export them."""
