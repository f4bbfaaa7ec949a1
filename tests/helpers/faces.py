"""A contract for import-linter: tests import the faces of folders, not the files behind them."""

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output
from importlinter.application import contract_utils


class FacesContract(Contract):
    """A test imports a folder, or a file that another folder of the package imports too.

    Each file of `programs` is run by people, and is a face of its own.
    """

    type_name = "faces"
    tests = fields.ModuleField()
    programs = fields.SetField(subfield=fields.StringField())
    ignore_imports = fields.SetField(subfield=fields.ImportExpressionField(), required=False)

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        contract_utils.remove_ignored_imports(
            graph=graph,
            ignore_imports=self.ignore_imports,  # type: ignore[arg-type]
            unmatched_alerting=contract_utils.AlertLevel.ERROR,
        )
        tests = graph.find_descendants(self.tests.name)  # type: ignore[attr-defined]
        reached = {
            (test, file)
            for test in tests
            for file in graph.find_modules_directly_imported_by(test) - tests
            if not graph.find_children(file) and not self.is_face(graph, file, tests)
        }
        return ContractCheck(kept=not reached, metadata={"reached": sorted(reached)})

    def is_face(self, graph: ImportGraph, file: str, tests: set[str]) -> bool:
        folder = file.rpartition(".")[0]
        above = {folder[:end] for end, letter in enumerate(folder) if letter == "."}
        importers = graph.find_modules_that_directly_import(file) - tests - {folder} - above
        return folder in self.programs or any(  # type: ignore[operator]
            other.rpartition(".")[0] != folder for other in importers
        )

    def render_broken_contract(self, check: ContractCheck) -> None:
        for test, file in check.metadata["reached"]:
            output.print_error(f"{test} reaches {file}")
