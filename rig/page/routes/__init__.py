"""The addresses of the HTTP interface, by subject; docs/reference/http.md lists them."""
