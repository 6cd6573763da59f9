"""Virtual rigs: recordings that a simulation plays, with sensor noise and a converter."""
