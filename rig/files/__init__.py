"""Files: recordings, models, rig descriptions, results; written whole, read with limits."""
