"""Deliberately naive filters: one run, plain loops, inverses, as a textbook prints them. They share no code with the
package.
"""
