"""The next run: open questions of diagnoses become a plan, and an investigation repeats this until one cause is identified."""
