"""A Run becomes metrics; metrics with a Requirement become a Verdict."""
