"""The next measurement: candidate runs, what every surviving cause predicts for them, and which of them parts the causes."""
