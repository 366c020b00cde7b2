// Names that the build needs besides those it finds in the sources: none.
