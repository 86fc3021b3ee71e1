"""Tables, code and pictures of the Markdown that git holds, and the site of it (scripts/docs.sh)."""
