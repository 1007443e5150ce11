"""Grammar that all commands share: arguments, composed configs, help, errors, exit codes."""
