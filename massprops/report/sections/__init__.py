"""One section of the page a file: TITLE, ORDER, `render(data) -> str`; an empty string leaves it out."""
