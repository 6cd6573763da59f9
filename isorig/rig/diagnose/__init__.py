"""The answer of a diagnosis: its content, what the recording lacks, and its files."""
