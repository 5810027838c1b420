"""Write evidence of a calibration as a digital calibration certificate (DCC 3.2.1, D-SI 2.1)."""

import math
from typing import TYPE_CHECKING, Final

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.calibration.campaign.campaign_subjects import Organisation
from analysis.calibration.use.error_limits import OUTSIDE, WITHIN
from estimators.errors import EvidenceError
from recordings.calibration.calibration_text import ESTIMATORS
from recordings.calibration.certificate_text import (
    iter_accuracy_class_sentences,
    make_traceability_warnings,
    read_certificate_issue_day,
)
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.dcc.dcc_document import DCC, SI, VERSION, require_xml_libraries
from recordings.dcc.dcc_quantity import add_dsi_real_element

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

_SHA256: Final = "SHA-256"
_CERTIFICATE: Final = "basic_certificateIdentification"
#: Standards that the fit, its uncertainties and its verdicts follow.
_METHODS: Final = (
    ("Straight line, errors in both variables", "ISO/TS 28037:2010", "basic_calibrationSOP"),
    ("Uncertainty of measurement", "JCGM 100:2008", "basic_methodMeasurementUncertainty"),
    ("Decision rule", "JCGM 106:2012", "payscope_decisionRule"),
)
#: refType, D-SI unit and name of each influence condition; texts have no unit.
_CONDITIONS: Final = (
    ("temperature_degC", "basic_temperature", r"\degreecelsius", "Air temperature"),
    ("slope_deg", "payscope_influenceCondition", r"\degree", "Slope of the ground"),
    ("surface", "payscope_influenceCondition", "", "Surface"),
    ("tyres", "payscope_influenceCondition", "", "Tyres"),
    ("fuel", "payscope_influenceCondition", "", "Fuel"),
)


def refuse_campaign_incomplete_for_dcc(campaign: CalibrationCampaign, source: object) -> None:
    """Raise an error for a campaign without data that the schema or ISO/IEC 17025, 7.8 requires.

    Raises:
        EvidenceError: data are missing, or a library is; it names every missing key.
    """
    require_xml_libraries()
    if campaign.missing_certificate_entries:
        keys = ", ".join(campaign.missing_certificate_entries)
        raise EvidenceError(f"{source}: a DCC needs {keys}; state them in the campaign")


def make_unsigned_dcc(document: EvidenceDocument, sums_sha256: str) -> "_Element":
    """Make the certificate of a calibration, unsigned.

    Args:
        document: evidence, the only source of the certificate's contents.
        sums_sha256: SHA-256 of the SHA256SUMS of the bundle, which binds certificate and bundle.

    Raises:
        EvidenceError: the evidence has no calibration line, or lacks data for a certificate.
    """
    refuse_campaign_incomplete_for_dcc(document.campaign, document.id)
    if document.kind != "calibration" or document.calibration is None:
        raise EvidenceError(f"{document.id}: has no calibration line, so no DCC can be made of it")
    from lxml import etree

    root = etree.Element(
        f"{{{DCC}}}digitalCalibrationCertificate",
        {"schemaVersion": VERSION},
        nsmap={"dcc": DCC, "si": SI},
    )
    _fill_administrative_data(_add_element(root, "administrativeData"), document, sums_sha256)
    _add_result_elements(_add_element(root, "measurementResults"), document)
    return root


def _add_element(
    parent: "_Element", name: str, text: str | None = None, **attributes: str
) -> "_Element":
    from lxml import etree

    made = etree.SubElement(parent, f"{{{DCC}}}{name}", attributes)
    if text is not None:
        made.text = " ".join(text.split())
    return made


def _add_language_text(parent: "_Element", name: str, text: str, **attributes: str) -> "_Element":
    made = _add_element(parent, name, **attributes)
    _add_element(made, "content", text, lang="en")
    return made


def _add_identification_element(
    parent: "_Element", issuer: str, value: str, description: str, ref_type: str
) -> None:
    made = _add_element(parent, "identification", refType=ref_type)
    _add_element(made, "issuer", issuer)
    _add_element(made, "value", value)
    _add_language_text(made, "name", description)


def _add_contact_element(parent: "_Element", name: str, organisation: Organisation) -> None:
    contact = _add_element(parent, name)
    _add_language_text(contact, "name", organisation.name)
    if organisation.email:
        _add_element(contact, "eMail", organisation.email)
    place = _add_element(contact, "location")
    _add_element(place, "city", organisation.city)
    _add_element(place, "countryCode", organisation.country)
    _add_element(place, "street", organisation.address)


def _add_sha256_element(
    parent: "_Element", name: str, referral_id_and_digest: tuple[str, str, str]
) -> None:
    referral, referral_id, digest = referral_id_and_digest
    made = _add_element(parent, name)
    _add_language_text(made, "referral", referral)
    _add_element(made, "referralID", referral_id)
    _add_element(made, "procedure", _SHA256)
    _add_element(made, "value", digest)


def _add_software_elements(parent: "_Element", document: EvidenceDocument) -> None:
    made = _add_element(parent, "software")
    _add_language_text(made, "name", "payscope")
    _add_element(made, "release", f"v{document.software.payscope}")
    _add_element(made, "type", "application")


def _add_ref_type_definitions(parent: "_Element", document: EvidenceDocument) -> None:
    """Add references to the definitions of the values of the attribute refType."""
    for namespace, name, link, release in (
        ("basic", "Terms for every certificate", "https://dccwiki.ptb.de", ""),
        (
            "payscope",
            "Terms that are not in the list of the namespace basic",
            "payscope/docs/evidence.md",
            f"v{document.software.payscope}",
        ),
    ):
        made = _add_element(parent, "refTypeDefinition")
        _add_language_text(made, "name", name)
        _add_element(made, "namespace", namespace)
        _add_element(made, "link", link)
        if release:
            _add_element(made, "release", release)


def _fill_administrative_data(
    admin: "_Element", document: EvidenceDocument, sums_sha256: str
) -> None:
    campaign = document.campaign
    about, machine, laboratory = campaign.campaign, campaign.machine, campaign.laboratory
    assert laboratory is not None
    assert campaign.customer is not None
    _add_software_elements(_add_element(admin, "dccSoftware"), document)
    _add_ref_type_definitions(_add_element(admin, "refTypeDefinitions"), document)
    core = _add_element(admin, "coreData")
    _add_element(core, "countryCodeISO3166_1", laboratory.country)
    _add_element(core, "usedLangCodeISO639_1", "en")
    _add_element(core, "mandatoryLangCodeISO639_1", "en")
    _add_element(core, "uniqueIdentifier", document.id)
    _add_identification_element(
        _add_element(core, "identifications"),
        "calibrationLaboratory",
        sums_sha256,
        "SHA-256 of SHA256SUMS of the evidence",
        "payscope_documentIdentification",
    )
    if about.received:
        _add_element(core, "receiptDate", about.received.isoformat())
    days = [run.day for run in campaign.runs]
    _add_element(core, "beginPerformanceDate", min(days).isoformat())
    _add_element(core, "endPerformanceDate", max(days).isoformat())
    _add_element(core, "performanceLocation", about.place_kind)
    _add_element(core, "issueDate", read_certificate_issue_day(document).isoformat())
    if about.replaces:
        changed = _add_element(core, "reportAmendedSubstituted")
        _add_element(changed, "typeOfChange", "substituted")
        _add_element(changed, "replacedUniqueIdentifier", about.replaces)
    before = document.chain.previous
    if before is not None:
        what = "SHA256SUMS of the evidence of this machine before this one"
        _add_sha256_element(core, "previousReport", (what, before.id, before.sums_sha256))
    item = _add_element(_add_element(admin, "items"), "item", id="machine")
    _add_language_text(item, "name", document.machine.machine.name)
    _add_language_text(item, "description", f"Condition: {machine.condition}")
    _add_language_text(_add_element(item, "manufacturer"), "name", machine.make)
    _add_element(item, "model", machine.model)
    identified = _add_element(item, "identifications")
    _add_identification_element(
        identified, "manufacturer", machine.id, "Serial number", "basic_serialNumber"
    )
    for part, value in machine.parts.items():
        if part.strip() and value.strip():
            _add_identification_element(
                identified, "other", value, part, "payscope_partIdentification"
            )
    _add_contact_element(_add_element(admin, "calibrationLaboratory"), "contact", laboratory)
    people = _add_element(admin, "respPersons")
    for name, role, signs in (
        (about.authoriser, about.authoriser_function, "true"),
        (about.author, about.author_function, "false"),
    ):
        person = _add_element(people, "respPerson")
        _add_language_text(_add_element(person, "person"), "name", name)
        if role:
            _add_element(person, "role", role)
        _add_element(person, "mainSigner", signs)
    _add_contact_element(admin, "customer", campaign.customer)
    _add_statement_elements(_add_element(admin, "statements"), document)


def _add_statement_elements(parent: "_Element", document: EvidenceDocument) -> None:
    about, limits = document.campaign.campaign, document.limits
    said = [("Scope", document.notice), ("Intended use", about.intended_use)]
    said += [("Place of the work", about.place), ("Deviations from the method", about.deviations)]
    said += [("Warning", text) for text in make_traceability_warnings(document)]
    said += [("Range and decision rule", text) for text in iter_accuracy_class_sentences(document)]
    if about.replaces_reason:
        said.append(("Reason of the replacement", about.replaces_reason))
    for name, text in said:
        made = _add_element(parent, "statement")
        _add_language_text(made, "name", name)
        _add_language_text(made, "declaration", text)
    if limits is not None:
        made = _add_element(parent, "statement", refType="basic_conformity")
        _add_language_text(made, "name", "Error limits")
        _add_element(made, "reference", limits.rule.accuracy_class)
        _add_language_text(made, "declaration", limits.statement)
        if limits.verdict in (WITHIN, OUTSIDE):
            _add_element(made, "conformity", "pass" if limits.verdict == WITHIN else "fail")


def _add_result_elements(parent: "_Element", document: EvidenceDocument) -> None:
    fitted = document.calibration
    assert fitted is not None
    result = _add_element(parent, "measurementResult", refId="machine")
    _add_language_text(result, "name", "Calibration of the mass that the machine's logs give")
    _add_language_text(
        result,
        "description",
        f"{ESTIMATORS.get(document.estimator.name, document.estimator.name)}; its definition has "
        f"the SHA-256 {document.estimator.definition_sha256}",
    )
    methods = _add_element(result, "usedMethods")
    for name, norm, ref in _METHODS:
        method = _add_element(methods, "usedMethod", refType=ref)
        _add_language_text(method, "name", name)
        _add_element(method, "norm", norm)
    _add_software_elements(_add_element(result, "usedSoftware"), document)
    _add_reference_mass_elements(_add_element(result, "measuringEquipments"), document)
    _add_influence_condition_elements(_add_element(result, "influenceConditions"), document)
    found = _add_element(result, "results")
    line_result = _add_element(found, "result", refType="payscope_calibrationFunction")
    _add_language_text(
        line_result, "name", "Line: calibrated mass = alpha times estimate plus beta"
    )
    data = _add_element(line_result, "data")
    for name, value, unit, interval in (
        ("alpha", fitted.alpha_1, r"\one", fitted.alpha_interval_1),
        ("beta", fitted.beta_kg, r"\kilogram", fitted.beta_interval_kg),
    ):
        quantity = _add_element(data, "quantity", refType="basic_measuredValue")
        _add_language_text(quantity, "name", name)
        low, high = interval
        if low is None or high is None or not low < value < high:
            add_dsi_real_element(quantity, value, unit)
        else:
            # D-SI requires a standard uncertainty with the interval: the one of equal half width
            u = (high - low) / 2.0 / fitted.coverage_k_1
            add_dsi_real_element(
                quantity, value, unit, interval=(u, low, high, fitted.confidence_1)
            )
    at_kg, readings = fitted.budget_at
    quantity = _add_element(data, "quantity", refType="basic_measuredValue")
    _add_language_text(quantity, "name", f"Later mass, mean of {readings} readings")
    fill_mass_quantity(quantity, document, at_kg)
    _add_indication_error_elements(
        _add_element(found, "result", refType="basic_measurementError"), document
    )


def fill_mass_quantity(
    quantity_element: "_Element", document: EvidenceDocument, mass_kg: float
) -> None:
    """Add a mass with its expanded uncertainty."""
    fitted = document.calibration
    assert fitted is not None
    at_kg, readings = fitted.budget_at
    k = fitted.coverage_k_1
    u_kg = fitted.u_kg
    if mass_kg != at_kg:
        u_kg = fitted.inversion.compute_later_mass_u_kg(mass_kg, readings)
    if not (math.isfinite(u_kg) and k >= 1.0):
        raise EvidenceError(
            f"{document.id}: cannot be certified at {mass_kg:g} kg: its standard uncertainty is "
            "not finite or its coverage factor is below 1"
        )
    add_dsi_real_element(
        quantity_element,
        mass_kg,
        r"\kilogram",
        expanded_uncertainty=(k * u_kg, k, fitted.confidence_1),
    )


def _add_indication_error_elements(result_element: "_Element", document: EvidenceDocument) -> None:
    """Add reference, calibrated mass and error of each run."""
    fitted = document.calibration
    assert fitted is not None
    references = {each.load_id: each for each in document.references}
    _add_language_text(result_element, "name", "Errors of the runs")
    data = _add_element(result_element, "data")
    for point in fitted.points:
        if point.error_kg is None:
            continue
        reference = references[point.load_id]
        row = _add_element(data, "list")
        _add_language_text(row, "name", f"{point.run_id}: {point.load_id}")
        quantity = _add_element(row, "quantity", refType="basic_referenceValue")
        add_dsi_real_element(
            quantity,
            reference.reference_kg,
            r"\kilogram",
            expanded_uncertainty=(2.0 * reference.u_kg, 2.0, 0.954),
        )
        quantity = _add_element(row, "quantity", refType="basic_measuredValue")
        fill_mass_quantity(quantity, document, reference.reference_kg + point.error_kg)
        quantity = _add_element(row, "quantity", refType="basic_measurementError")
        add_dsi_real_element(quantity, point.error_kg, r"\kilogram")


def _add_reference_mass_elements(parent: "_Element", document: EvidenceDocument) -> None:
    """Add the reference masses, with hashes of their certificates if known."""
    campaign = document.campaign
    machine = document.machine.machine
    for mass in campaign.masses:
        made = _add_element(parent, "measuringEquipment", refType="basic_measurementStandard")
        _add_language_text(made, "name", f"Reference mass {mass.id}")
        if mass.stated_by:
            _add_language_text(made, "description", f"Stated by the {mass.stated_by}")
        elif mass.certificate_sha256:
            about = ("Certificate of the mass", mass.certificate, mass.certificate_sha256)
            _add_sha256_element(made, "certificate", about)
        identified = _add_element(made, "identifications")
        _add_identification_element(
            identified, "calibrationLaboratory", mass.id, "Id", "payscope_equipmentIdentification"
        )
        if mass.certificate:
            _add_identification_element(
                identified, "other", mass.certificate, "Certificate", _CERTIFICATE
            )
        _add_reference_mass_quantity(made, "Mass", mass.value_kg, mass.u_kg)
    if campaign.method.estimator != "joint_payload" and machine.empty_mass_kg is not None:
        made = _add_element(parent, "measuringEquipment", refType="basic_measurementStandard")
        _add_language_text(made, "name", "The machine without load")
        if campaign.machine.empty_certificate:
            _add_identification_element(
                _add_element(made, "identifications"),
                "other",
                campaign.machine.empty_certificate,
                "Certificate",
                _CERTIFICATE,
            )
        _add_reference_mass_quantity(
            made, "Empty mass", machine.empty_mass_kg, machine.empty_mass_u_kg or 0.0
        )


def _add_reference_mass_quantity(
    equipment_element: "_Element", name: str, value_kg: float, u_kg: float
) -> None:
    quantity = _add_element(
        _add_element(equipment_element, "measuringEquipmentQuantities"),
        "measuringEquipmentQuantity",
        refType="basic_referenceValue",
    )
    _add_language_text(quantity, "name", name)
    add_dsi_real_element(
        quantity, value_kg, r"\kilogram", expanded_uncertainty=(2.0 * u_kg, 2.0, 0.954)
    )


def _add_influence_condition_elements(parent: "_Element", document: EvidenceDocument) -> None:
    campaign = document.campaign
    runs = [campaign.fill_run_conditions_from_campaign(run) for run in campaign.runs]
    for key, ref, unit, name in _CONDITIONS:
        for value in dict.fromkeys(each[key] for each in runs):
            made = _add_element(parent, "influenceCondition", refType=ref)
            _add_language_text(made, "name", name)
            data = _add_element(made, "data")
            if unit:
                quantity = _add_element(data, "quantity", refType="basic_measuredValue")
                add_dsi_real_element(quantity, value, unit)
            else:
                _add_language_text(data, "text", value)
