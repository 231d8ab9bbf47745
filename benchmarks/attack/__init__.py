"""Does anything run from a file, get lost or hang? Generated inputs, each in its own process."""
