"""The science: takes arrays, returns frozen results. No files, devices, plots or clock."""
