"""Files: recordings, models, rig descriptions, results; written atomically, read with size limits."""
