"""The front door: every rule that makes a result valid is reached from here."""
