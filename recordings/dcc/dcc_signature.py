"""Check and create XML signatures that cover a whole certificate."""

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import DS

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

#: Accepted signature methods: no SHA-1, no DSA, and no HMAC, whose key is not secret.
_METHODS: Final = (
    *("ECDSA_SHA256", "ECDSA_SHA384", "ECDSA_SHA512"),
    *("RSA_SHA256", "RSA_SHA384", "RSA_SHA512"),
    *("SHA256_RSA_MGF1", "SHA384_RSA_MGF1", "SHA512_RSA_MGF1"),
)
_DIGESTS: Final = ("SHA256", "SHA384", "SHA512")
#: Accepted transforms of the only reference: without the signature, in canonical form; XPath or
#: XSLT could restrict a signature to a part.
_TRANSFORMS: Final = (
    "http://www.w3.org/2000/09/xmldsig#enveloped-signature",
    "http://www.w3.org/2001/10/xml-exc-c14n#",
    "http://www.w3.org/TR/2001/REC-xml-c14n-20010315",
    "http://www.w3.org/2006/12/xml-c14n11",
)
_ASK_FOR_SIGNED: Final = "ask the laboratory for a certificate signed as a whole"
#: Bits below which an RSA key is weak (NIST SP 800-131A).
_RSA_BITS_MIN: Final = 2048


@dataclass(frozen=True, slots=True)
class SignedDcc:
    """Signed part of a certificate.

    Attributes:
        root: root element to read; if there is a signature, only what it covers.
        key_id: SHA-256 of the signing key; "" if unsigned.
    """

    root: "_Element"
    key_id: str

    def describe_signature(self, trusted_key_ids: Collection[str]) -> str:
        """Say who signed the certificate.

        Args:
            trusted_key_ids: ids of keys given by the user.
        """
        if not self.key_id:
            return UNSIGNED
        if self.key_id in trusted_key_ids:
            return f"{TRUSTED} {self.key_id[:12]}…"
        return f"signed by an unknown key {self.key_id[:12]}…"


UNSIGNED: Final = "unsigned"
TRUSTED: Final = "signed by a key of dcc_keys,"


def check_dcc_signature(certificate: "_Element", certificate_name: str) -> SignedDcc:
    """Check the signature of a certificate, if it has one.

    Args:
        certificate: root element of the certificate.
        certificate_name: name of the certificate, for errors.

    Raises:
        EvidenceError: a signature is invalid, covers only a part, is at another place, is not the
            only one, or uses a weak method or key.
    """
    found = list(certificate.iter(f"{{{DS}}}Signature"))
    if not found:
        return SignedDcc(certificate, "")
    if len(found) > 1:
        raise EvidenceError(
            f"{certificate_name}: has {len(found)} signatures, but only one over the whole "
            f"certificate is supported; {_ASK_FOR_SIGNED}"
        )
    if found[0].getparent() is not certificate:
        raise EvidenceError(
            f"{certificate_name}: its ds:Signature is not directly below the root element, so it "
            f"is not accepted; {_ASK_FOR_SIGNED}"
        )
    references = list(found[0].iter(f"{{{DS}}}Reference"))
    if len(references) != 1 or references[0].get("URI") != "":
        raise EvidenceError(
            f"{certificate_name}: its signature does not cover the whole certificate; "
            f"{_ASK_FOR_SIGNED}"
        )
    strange = [
        str(each.get("Algorithm"))
        for each in references[0].iter(f"{{{DS}}}Transform")
        if each.get("Algorithm") not in _TRANSFORMS
    ]
    if strange:
        raise EvidenceError(
            f"{certificate_name}: its signature uses the unsupported transform {strange[0]}; ask "
            "the laboratory for a certificate signed without it"
        )
    signed, pem = _verify_signed_element(certificate, found[0], certificate_name)
    if len(list(signed.iter(f"{{{DS}}}Signature"))) or signed.tag != certificate.tag:
        raise EvidenceError(
            f"{certificate_name}: its signature does not cover the whole certificate; "
            f"{_ASK_FOR_SIGNED}"
        )
    return SignedDcc(signed, compute_key_id_of_pem(pem, certificate_name))


def _verify_signed_element(
    certificate: "_Element", signature: "_Element", certificate_name: str
) -> tuple["_Element", bytes]:
    """Verify a signature; return the signed element, and the signer's public key (PEM or DER)."""
    from cryptography import x509
    from signxml.algorithms import DigestAlgorithm, SignatureMethod
    from signxml.exceptions import SignXMLException
    from signxml.verifier import SignatureConfiguration, XMLVerifier

    config = SignatureConfiguration(
        require_x509=False,
        location="./",
        signature_methods=frozenset(SignatureMethod[name] for name in _METHODS),
        digest_algorithms=frozenset(DigestAlgorithm[name] for name in _DIGESTS),
    )
    options: dict[str, Any] = {}
    pem = b""
    held = signature.find(f".//{{{DS}}}X509Certificate")
    try:
        if held is not None:
            # trust is decided by the key, not by a chain of certificates to some authority
            text = "".join((held.text or "").split())
            pem = f"-----BEGIN CERTIFICATE-----\n{text}\n-----END CERTIFICATE-----\n".encode()
            options["x509_cert"] = x509.load_pem_x509_certificate(pem)
        result = XMLVerifier().verify(certificate, expect_config=config, **options)
    except (SignXMLException, ValueError, TypeError, KeyError, AttributeError) as fault:
        raise EvidenceError(
            f"{certificate_name}: its signature is not valid "
            f"({str(fault)[:160] or type(fault).__name__}); ask its issuer for the certificate "
            "again"
        ) from None
    except Exception as fault:  # noqa: BLE001  a stranger chose the bytes; cryptography has its own
        raise EvidenceError(
            f"{certificate_name}: its signature cannot be verified ({type(fault).__name__}); ask "
            "its issuer for the certificate again"
        ) from None
    if isinstance(result, list) or result.signed_xml is None:
        raise EvidenceError(
            f"{certificate_name}: its signature does not cover the whole certificate; "
            f"{_ASK_FOR_SIGNED}"
        )
    return result.signed_xml, pem or result.signature_key


def compute_key_id_of_pem(pem_bytes: bytes, key_name: str) -> str:
    """Compute the SHA-256 of a public key's SubjectPublicKeyInfo in DER."""
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec, rsa

    try:
        if b"CERTIFICATE" in pem_bytes:
            key = x509.load_pem_x509_certificate(pem_bytes).public_key()
        else:
            key = serialization.load_pem_public_key(pem_bytes)
    except ValueError:
        raise EvidenceError(
            f"{key_name}: has no public key or certificate in PEM; ask the laboratory for its key"
        ) from None
    if isinstance(key, rsa.RSAPublicKey) and key.key_size < _RSA_BITS_MIN:
        raise EvidenceError(
            f"{key_name}: an RSA key of {key.key_size} bits is too short; ask the laboratory for a "
            f"certificate signed with at least {_RSA_BITS_MIN}"
        )
    if not isinstance(key, rsa.RSAPublicKey | ec.EllipticCurvePublicKey):
        raise EvidenceError(
            f"{key_name}: its key is neither RSA nor ECDSA; ask the laboratory for such a key"
        )
    der = key.public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    return hashlib.sha256(der).hexdigest()


def read_key_id_from_pem_file(path: Path) -> str:
    """Compute the id of a key in a PEM file: a public key, or a certificate with one.

    Raises:
        EvidenceError: the file cannot be read, or has no such key.
    """
    try:
        return compute_key_id_of_pem(path.read_bytes(), str(path))
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from None


@dataclass(frozen=True, slots=True)
class DccKey:
    """Private key that signs certificates, and the key's own certificate, if any; both in PEM."""

    private: bytes
    certificate: bytes | None
    method: str


def read_dcc_signing_key(path: Path, certificate: Path | None = None) -> DccKey:
    """Read the key that signs certificates.

    It is separate from the Ed25519 key, since few programs support XML signatures by Ed25519.

    Raises:
        EvidenceError: the key cannot be read, is neither ECDSA nor RSA, or is not that of the
            certificate.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec, rsa

    try:
        private = path.read_bytes()
        held = None if certificate is None else certificate.read_bytes()
        key = serialization.load_pem_private_key(private, None)
        own = None if held is None else x509.load_pem_x509_certificate(held).public_key()
    except OSError as error:
        raise EvidenceError(f"{error.filename}: cannot be read ({error.strerror})") from None
    except (ValueError, TypeError):
        raise EvidenceError(
            f"{path}: is not a private key in PEM without a password, or its certificate is not "
            "valid"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey):
        raise EvidenceError(
            f"{path}: an XML signature needs an ECDSA or RSA key; make one with `openssl genpkey "
            "-algorithm EC -pkeyopt ec_paramgen_curve:P-256`"
        )
    if isinstance(key, rsa.RSAPrivateKey) and key.key_size < _RSA_BITS_MIN:
        raise EvidenceError(
            f"{path}: an RSA key of {key.key_size} bits is too short; give one of at least "
            f"{_RSA_BITS_MIN}"
        )
    if own is not None and own != key.public_key():
        raise EvidenceError(
            f"{certificate}: is not the certificate of {path}; give the one of this key"
        )
    method = "ecdsa-sha256" if isinstance(key, ec.EllipticCurvePrivateKey) else "rsa-sha256"
    return DccKey(private, held, method)


def sign_dcc(certificate: "_Element", signing_key: DccKey) -> "_Element":
    """Sign a certificate as a whole, and return it with the signature."""
    from signxml import methods
    from signxml.algorithms import CanonicalizationMethod
    from signxml.signer import XMLSigner

    signer = XMLSigner(
        method=methods.enveloped,
        signature_algorithm=signing_key.method,
        digest_algorithm="sha256",
        c14n_algorithm=CanonicalizationMethod.EXCLUSIVE_XML_CANONICALIZATION_1_0,
    )
    held = None if signing_key.certificate is None else signing_key.certificate.decode()
    return signer.sign(
        certificate, key=signing_key.private, cert=held, always_add_key_value=held is None
    )
