"""What the site in docs/ takes from the rest of the repository: tables, included pages, pictures. scripts/docs.sh builds it."""
