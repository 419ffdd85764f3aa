"""The command line: argument handling and printing, one small file per command."""
