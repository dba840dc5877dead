"""The studio: a local web page on which a test engineer works. It holds no rule: it calls `rvsg` and `rvsg.app`."""
