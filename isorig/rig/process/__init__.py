"""The process of a command: its terminal, its interrupts, its interpreter."""
