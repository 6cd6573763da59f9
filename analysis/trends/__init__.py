"""Parameters over campaigns: scatter, alarms, dated changes, and comparison with sibling rigs."""
