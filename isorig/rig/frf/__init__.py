"""Transfer functions of a whole recording, and their figures."""
