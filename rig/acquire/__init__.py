"""A lab session: a plan in, a recording out, nothing lost without being counted."""
