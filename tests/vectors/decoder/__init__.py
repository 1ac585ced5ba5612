"""A decoder of frame bodies from docs/spec/codec.md alone: slow and plain, a second opinion on that text."""
