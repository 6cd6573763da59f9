"""The thesis's tables and figures recomputed with the virtual rig, compared with the printed ones."""
