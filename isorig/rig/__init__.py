"""The lab application: sessions, storage, pictures, reports, the command line."""
