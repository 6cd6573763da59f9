"""A rig's description: drawing, questions, and which parameters its sensors determine."""
