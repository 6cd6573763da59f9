"""Modal analysis of a file: transfer functions in; modes, pictures and an animated page out."""
