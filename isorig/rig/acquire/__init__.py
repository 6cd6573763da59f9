"""Sessions: from a plan to a recording, with every lost sample counted."""
