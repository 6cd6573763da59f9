"""The isolation ratio of a recording, compared with simulations, and the ratio of any two configurations."""
