"""The words of everything else: machine, settings, schema, methods, run, verdict, answer."""
