"""Parameter tables of the wire bonder: the joint fit, and the thesis's four set-ups."""
