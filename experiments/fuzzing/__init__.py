"""Readers and updates given what nobody would write: mutated files, arbitrary scans."""
