import pytest

from rsvideo.config import address


@pytest.mark.parametrize(
    "text", ["s3://bucket/a b/clip (1).mp4", "gs://bucket/a", "az://bucket/a.mp4", "abfs://bucket/a.mp4", "s3://bucket"]
)
def test_an_address_comes_out_as_it_went_in(text: str) -> None:
    assert address.is_address(text)
    assert str(address.parsed(text)) == text


@pytest.mark.parametrize("text", ["clips/a.mp4", "C:\\\\a.mp4", "a::b.mp4", "/abs/a.mp4", "s3:/bucket/a.mp4"])
def test_names_of_files_are_no_addresses(text: str) -> None:
    assert not address.is_address(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("http://host/a.mp4", "must begin with s3://"),
        ("https://host/a.mp4", "must begin with s3://"),
        ("file:///etc/passwd", "must begin with s3://"),
        ("S3://bucket/a", "must begin with s3://"),
        ("memory://a", "must begin with s3://"),
        ("local://a", "must begin with s3://"),
        ("simplecache::s3://bucket/a.mp4", "chain no others"),
        ("s3://bucket/a.zip::file:///etc/passwd", "chain no others"),
        ("zip://a.mp4::s3://bucket/a.zip", "chain no others"),
        ("s3://me:secret@bucket/a.mp4", "must not hold a user or a password"),
        ("http://me:secret@host/a.mp4", "must begin with s3://"),
        ("s3:///a.mp4", "must name a bucket"),
        ("s3://../a.mp4", "must name a bucket"),
        ("s3://bu?ket/a.mp4", "must name a bucket"),
        ("s3://bucket/../a.mp4", "no parts such as .."),
        ("s3://bucket/a/./b.mp4", "no parts such as .."),
        ("s3://bucket//a.mp4", "no parts such as .."),
        ("s3://bucket/a\x1b[2J.mp4", "no control characters"),
        ("s3://bucket/a\nb.mp4", "no control characters"),
        ("s3://bucket/a\\..\\b.mp4", "no control characters"),
        ("s3://bucket/" + "a" * 1025, "at most 1024 bytes"),
    ],
)
def test_what_might_reach_what_nobody_meant_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words.replace(".", "\\.")) as caught:
        address.parsed(text)
    assert "secret" not in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 250


def test_a_path_within_a_bucket_stays_the_same_when_the_bucket_moves() -> None:
    assert address.relative("s3://one/clips/a.mp4", "s3://one/restored") == "../clips/a.mp4"
    assert address.relative("s3://two/clips/a.mp4", "s3://two/restored") == "../clips/a.mp4"
    assert address.relative("s3://one/a.mp4", "s3://one") == "a.mp4"
    assert address.relative("s3://one/clips/a.mp4", "s3://two/restored") == "s3://one/clips/a.mp4"
