"""What a plugin author needs: the conformance suite, reference scenes and the exact NumPy backend."""
