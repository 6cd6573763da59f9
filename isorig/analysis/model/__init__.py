"""Rigs as data: bodies, links, contacts, drive, sensors; the built-in rigs."""
