"""The thesis's tables and figures worked out anew from the virtual rig, beside what the thesis printed."""
