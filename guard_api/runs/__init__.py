"""Run directories: manifests, metrics, checkpoints, all written atomically."""
