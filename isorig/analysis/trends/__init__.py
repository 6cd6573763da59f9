"""Parameters over campaigns: scatter, alarms, dated changes, and comparison with other rigs."""
