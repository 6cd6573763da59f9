"""The model of a recording: its baseline, and what it predicts."""
