"""What things are called: identifiers, contents, files, features."""
