"""Virtual rigs: simulated recordings with sensor noise and a converter."""
