"""The operator's screen: shows a running session in a browser, with buttons that control it."""
