"""What notebooks see: `tables` converts results to xarray and pandas, `plots` draws them, `pages` gives their HTML, and `answers`
calls whole analyses with the campaign's own rig. Importing `isorig.names` registers all of it.
"""
