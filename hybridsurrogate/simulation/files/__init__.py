"""Runs and measurements on disk.

table_file       tables in csv, Parquet and NetCDF files
measured_table   measured tables of the command line
run_store        finished runs, each written at once
"""
