"""The published study: its file formats, its as-logged measures and its tables. Nothing else imports this room."""
