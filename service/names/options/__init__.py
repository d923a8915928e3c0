"""What forms say of options, in languages other than that of the schemas; one file a process and language."""
