"""The next run: what diagnoses leave open becomes a plan, and an investigation goes from plan to plan until one cause stands."""
